"""A second withheld study: rigs of other friction, masses and integrators than the generator's.

With that they share ``servo_models.withheld.rig``, with the package nothing that simulates.

::

    python -m studies second_plant --seed 1 --cases 150 --folder runs/plant-1
    python -m studies second_plant --seed 1 --cases 110 --mix limits --folder runs/limits-1
    python -m studies second_plant --six --folder runs/six      # six rigs with play and delay

``firmware`` is the loop of a smart servo; ``two_mass`` and ``mujoco_plant`` are what it moves;
``rigs`` draws one and describes it as its owner would; ``judge`` says what an observer who knows
the truth can tell; ``figures`` are the figures and their bars.
"""
