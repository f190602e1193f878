"""Maps: workspaces, the formats they are read from and written to, and those made by generators."""
