"""One fit of a model to its logs: how it is made, and how it is judged on what it has not seen."""
