"""The store of sweeps: an SQLite file, with its tables, its lock and its integrity checks."""
