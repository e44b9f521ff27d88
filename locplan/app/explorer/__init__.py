"""The explorer: a page in the browser to see and change a map, its weak spots and paths."""
