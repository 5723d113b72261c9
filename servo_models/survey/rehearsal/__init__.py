"""What the logs of a command would show of each effect, before it is played."""
