"""Reading files of tables, JSON and XML without trust, and lines of drawings as members."""
