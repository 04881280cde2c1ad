"""Robots for the eyes: pictures, films, and the browser."""
