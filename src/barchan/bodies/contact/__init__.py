"""Contacts between rigid bodies: a broad phase linear in their number, and exact tests of the pairs it leaves.

geometry = ContactGeometry.of(bodies, dimension=3)
contacts = geometry.detect(states, reach=1e-3)
pair, depth = deepest(contacts)
"""

from __future__ import annotations

from barchan.bodies.contact.contact_set import ContactSet, deepest
from barchan.bodies.contact.crossing import Crossings, crossing
from barchan.bodies.contact.geometry import ContactGeometry

__all__ = ["ContactGeometry", "ContactSet", "Crossings", "crossing", "deepest"]
