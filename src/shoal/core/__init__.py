"""Code that all parts use: problems, episodes, checks of input, errors, files, registries, interruptions by the user."""
