"""Reports on picks: table, Markdown, CSV, JSON with a schema, and an HTML page with a 3D view."""
