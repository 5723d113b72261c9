"""What the figures of this project rest on: withheld cases, a second plant, and one study a file.

Nothing in ``servo_models`` needs it but ``servo-models blind``.  ``python -m studies`` lists the
studies; ``python -m studies NAME --help`` says what one does.
"""
