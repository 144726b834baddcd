"""The functions that commands and users call, one module per verb; `ocptip` exports them."""
