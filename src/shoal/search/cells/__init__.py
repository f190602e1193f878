"""The cells of a region: grid, viewpoints, portals between cells, paths and distances, and footprints."""
