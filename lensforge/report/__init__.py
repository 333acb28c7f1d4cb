"""The pictures and the page that show a result."""
