"""Shared by all tests."""

from __future__ import annotations

import signal

# A shell starts what runs in its background with Ctrl-C ignored, and the tests' programs would inherit that.
signal.signal(signal.SIGINT, signal.default_int_handler)
