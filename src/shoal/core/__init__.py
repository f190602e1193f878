"""The ground floor, which all parts stand on: problems, episodes, checks of input, errors, files, registries, interruption."""
