"""The wiring of a scenario: which boxes fly, and which reads which. Every player is made of it.

whole.py     world and onboard half in one wiring
world.py     the vehicle, its sensors and their links
onboard.py   fixes, handler, filter, servo and planner
"""
