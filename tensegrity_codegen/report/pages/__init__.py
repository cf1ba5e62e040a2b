"""Self-contained HTML pages: tables, diagrams, pictures."""
