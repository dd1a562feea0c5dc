"""Room `flows`: continuum models of granular and viscoplastic matter; each builds a discrete Coulomb friction problem.

`flows.mpm` is the material point method of seed B, chapter 7.
"""
