"""Real recordings with a channel withheld: what is cut off is sealed and opened after the verdict."""
