"""Quality of the cells of a grid: measures, aggregates for optimization, reports."""
