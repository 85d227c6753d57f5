"""What everything stands on: numbers, sparse systems, texts and optional packages; no geometry."""
