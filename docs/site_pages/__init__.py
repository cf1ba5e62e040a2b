"""What the pages of the documentation site take from elsewhere."""
