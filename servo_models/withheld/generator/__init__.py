"""Rigs with a withheld effect, made by a simulation of their own.

Nothing here, nor in ``servo_models.withheld.rig``, is shared with the models of the product, on
purpose: other states (flux instead of current, natural frequency and ratios instead of
constants), other integrator (Heun's third order on a fine grid, events located by bisection), other
laws (friction of a bristle, play and stops as stiff contacts, hysteresis with an exponent).  What
a diagnosis says about friction, play and hysteresis is therefore said about a model that is a
little wrong, as every model is.  Other effects have one law only: there the models, given the
truth, are right to 1 %.
"""
