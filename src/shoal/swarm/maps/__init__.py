"""Maps: workspaces, map file formats and map generators."""
