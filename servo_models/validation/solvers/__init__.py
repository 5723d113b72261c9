"""Independent references: the physics of the papers written a second time, on purpose.

Nothing in this package uses a block, an actuator or the stepper.  Every right-hand side
and every number is taken from the papers again, in the paper's own units, and solved by
other means: the matrix exponential for linear sets, ``scipy.integrate.solve_ivp`` with
located events for the others.  An error would have to be made twice, in two forms, to
pass unseen.  The rigs of ``blind/generator`` are a third form, of other laws.

A reference is called with times [s] of shape (n,) and input columns of shape (n,) in SI,
held from their row on, and returns output columns of shape (n,) in SI: the values at the
end of the step that led to each row.
"""
