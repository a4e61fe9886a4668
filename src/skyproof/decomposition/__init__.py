"""Model the correlation of one satellite's signals within a chip, and decompose it."""
