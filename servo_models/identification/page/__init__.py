"""What the page of a diagnosis still draws by; ``identification.readings`` is for new code."""
