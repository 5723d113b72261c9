"""Transfer functions from measured records: estimate, compare, choose."""
