"""Pure functions from stored values to what a page shows: text, numbers, charts."""
