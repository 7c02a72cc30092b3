"""From samples of voltage and current to a belief about the pack's state."""
