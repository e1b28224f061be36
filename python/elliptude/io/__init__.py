"""Files: tables, logs and TOML, read and written."""
