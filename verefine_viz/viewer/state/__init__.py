"""What is open and how it is shown: all that changes while the page is used."""
