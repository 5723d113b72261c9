"""What was measured: readers, descriptions of logs, their audit, and files of parameters."""
