"""What the simulated rigs of all studies share, and nothing of ``servo_models``.

``laws``: clipping, dead zone, rounding to codes, the duty of a firmware, shapes of motions.
``recording``: the files of a recording.  Integrators, friction and contacts are not shared: the
second plant is there to have others than ``withheld.generator``.
"""
