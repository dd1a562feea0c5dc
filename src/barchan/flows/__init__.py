"""Room `flows`: continuum models of granular and viscoplastic matter.

`flows.mpm` (material points, seed B chapter 7) and `flows.dense` (finite elements, seed A) build discrete Coulomb friction
problems; `flows.quasi_newtonian` (seed C) has smooth, regularised viscosities and Newton methods of its own.
"""
