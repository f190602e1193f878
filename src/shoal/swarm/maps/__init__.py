"""Maps of a swarm: workspaces, map file formats and map generators."""
