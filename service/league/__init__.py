"""The league of all systems, for the dashboard: standings of the rows that come with dohyo."""
