"""The wiring of a scenario: which boxes fly, and which reads which. Every player is made of it.

whole.py           world and onboard half in one wiring
truth.py           how the world of one seed differs
world.py           the vehicle, what acts on it, the sensors and their links
onboard.py         an estimator, the servo and the planner, and what the servo knows of the way of its commands
intermittent.py    the paper's estimator
tight.py           the tight filter
messages.py        what an onboard half that is alone hears, and what makes detections and fixes of it
systems.py         boxes that Drake Systems play, where no element can
own_part.py        an estimator, a servo or a planner of one's own
"""
