"""A model that is deformed interactively: its state, and the page that shows it."""
