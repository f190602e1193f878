"""Code that swarm, steering and search share: problems, episodes, checks of input, errors, files,
registries, interruptions.
"""
