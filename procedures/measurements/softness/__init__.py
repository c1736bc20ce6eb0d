"""The softness test: Young moduli of unknown objects from their force ratios."""
