"""The report of a benchmark: tables and figures in Markdown."""
