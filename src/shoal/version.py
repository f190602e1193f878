"""The version of Shoal."""

VERSION = "0.1.0"
