"""Reading files of tables, JSON and XML without trust."""
