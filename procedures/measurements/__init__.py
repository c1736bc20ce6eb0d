"""The procedures: one folder each, with its report."""
