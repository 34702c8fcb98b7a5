"""The wiring of a scenario: which boxes fly, and which reads which. Every player is made of it.

whole.py           world and onboard half in one wiring
blocks.py          the paper's block diagram of it, to be looked at
truth.py           how the world of one seed differs
world.py           the sensors and their links
vehicle.py         the vehicle and what acts on it
onboard.py         an estimator, the servo and the planner
intermittent.py    the paper's estimator
fixes.py           what makes fixes of messages
tight.py           the tight filter
servo.py           the servo and what it reckons with
own_part.py        an estimator, a servo or a planner of one's own
"""
