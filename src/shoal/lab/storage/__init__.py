"""The store of a sweep: an SQLite file with its lock, its checks and its tables."""
