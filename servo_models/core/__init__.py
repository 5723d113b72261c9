"""What a model is and how it runs: blocks, plants, the flattener and the simulation."""
