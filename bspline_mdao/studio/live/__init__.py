"""A model that is deformed while one looks on: its state, and the page that shows it."""
