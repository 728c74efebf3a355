"""What a filter may have done wrong, without labels: bodies that it removed, and clutter that it kept."""
