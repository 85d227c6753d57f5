"""Forces of a flow: coefficients, loads along the span, hinges, induced drag."""
