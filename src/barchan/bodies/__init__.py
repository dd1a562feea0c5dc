"""Discrete bodies: `barchan.bodies.rigid` holds rigid bodies, their shapes, motions and states.

A room below the flows: bodies know nothing of the sand they meet, a flow asks them for distances, normals and velocities.
"""
