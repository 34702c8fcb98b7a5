"""numba's compiled functions and where they are kept.

digest.py   what a compiled function is made of
cached.py   njit functions whose compiled code is kept under that digest
"""
