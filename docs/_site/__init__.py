"""What the documentation site makes itself: links into the repository, and the pages of the reference."""
