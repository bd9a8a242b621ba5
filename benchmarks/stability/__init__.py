"""Hard models: each is right within its stated error, or an error names the cause."""
