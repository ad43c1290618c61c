"""The page and the printed report."""
