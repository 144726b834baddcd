"""What every package needs: errors, reading of TOML, files that appear whole, numbers as people read them."""
