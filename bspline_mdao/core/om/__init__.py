"""All that imports OpenMDAO: components, groups, flows and drivers, thin over the kernels of the other folders."""
