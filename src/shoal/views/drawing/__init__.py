"""Common drawing tools of all views: a canvas for film frames, the style of charts, confidence
bands, and film encoding.
"""
