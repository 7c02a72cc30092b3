"""How long the pack will still carry the vehicle, as a distribution."""
