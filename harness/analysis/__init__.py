"""Records as tables: selections, names and ratios that figures, tables and claims share."""
