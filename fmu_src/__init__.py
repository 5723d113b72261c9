"""What an FMU is made of: the slave, its variables, its model description, its archive."""
