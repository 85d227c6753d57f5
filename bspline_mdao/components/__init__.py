"""OpenMDAO components: each unpacks its inputs, calls one kernel and packs the outputs."""
