"""Flows and structures in the roles of MPhys."""

from ....core.om import mphys as mphys  # which says what to install where MPhys is missing
