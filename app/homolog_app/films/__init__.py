"""Films and stills of shapes that move along modes, between groups or on a turntable; no Qt.

`settings` is quick to import; the other modules bring Warp and matplotlib.
"""
