"""OpenFOAM as a flow solver: its programs run in case folders, and forces and pressures are read from their fields."""
