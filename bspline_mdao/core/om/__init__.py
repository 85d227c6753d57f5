"""All that imports OpenMDAO: components, groups, flows and drivers, thin layers over the kernels of other folders."""
