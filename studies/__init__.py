"""What the figures of this project rest on: withheld answers, a second plant, studies.

A folder for checkouts: the wheel has ``servo_models.withheld``, which makes and judges withheld
cases.  ``python -m studies`` lists all; ``python -m studies NAME --help`` says what one does.
"""
