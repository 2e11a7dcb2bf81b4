"""The documents that `--json` prints, declared once: keys in their order, types, units and meaning."""
