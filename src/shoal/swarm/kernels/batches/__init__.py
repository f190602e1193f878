"""Many worlds at once: one command each, how they begin, and what is seen of them as bytes."""
