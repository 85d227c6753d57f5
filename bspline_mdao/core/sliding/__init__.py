"""Fixed surfaces, plane and curved, that nodes of a grid slide on."""
