"""What is shown of a run: sentences, tables, figures, one page, one flight."""
