"""The prism of three bars under load: the tables of LIN, its largest load, and what they depend on."""
