"""The cells of a region: the grid, viewpoints, portals between cells, routes and distances, footprints."""
