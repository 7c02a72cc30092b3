"""Why recordings differ from what the battery model says: where, by which physics, and with what proof."""
