"""Planning of a search: orientation of the rows, viewpoints, allocation and routes."""
