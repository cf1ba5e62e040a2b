"""Reading files of tables, JSON and XML without trust."""

__all__: list[str] = []
