"""Tables as programs and people export them: what each column is, and the records in them."""
