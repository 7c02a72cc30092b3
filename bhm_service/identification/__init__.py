"""From recordings of a cell or pack to the parameters of its models."""
