"""What the scenes of the material point method share: tables of their files, grid and walls, free surfaces, figures."""
