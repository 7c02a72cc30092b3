"""What the commands of `bhm` do between the command line and the rooms."""
