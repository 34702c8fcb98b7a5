"""How numba compiles functions here, and where compiled code is kept.

digest.py     a digest of a function and of all code that the function calls
cached.py     njit functions whose compiled code is kept under that digest
generated.py  generated modules and the folder that keeps them
inlined.py    functions that only compiled code calls, compiled for their callers
shorter.py    numba's longest detours while it compiles, in shorter ways
addresses.py  arrays and records at an address, for compiled code
"""
