"""Modules that all parts of Shoal use: problems, episodes, input checks, errors, files, registries and interruption."""
