"""The studio's page: what a session holds, drawn with NiceGUI. It asks a `Studio` and nothing behind it."""
