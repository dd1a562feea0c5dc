"""Fibres: elastic rods, how their ends are held, contact between them and their stepping (seed B, 4.2)."""
