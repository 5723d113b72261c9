"""How results look: texts and tables for a terminal, pages of HTML."""
