"""What a package can add to seaclutter: a small example of each kind."""
