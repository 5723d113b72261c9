"""What an FMU is made of: the slave, its variables, its model description, its archive."""

import servo_models.errors  # noqa: F401  # first, since the package's ``build`` comes back to here
