"""Reports: documents of tables, charts and pictures, as HTML, Markdown and JSON."""
