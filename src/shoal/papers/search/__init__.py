"""Paper H, exhaustive search along a space-filling curve: its figure 5, its baselines and its curves, measured anew."""
