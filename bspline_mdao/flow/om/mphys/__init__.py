"""Flows and structures in the roles of MPhys."""

from ....core.om import mphys as mphys  # it says what to install if MPhys is missing
