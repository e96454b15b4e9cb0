/** Commands for a shell that make a world, and that join one. */

import { command } from "../command.js";

/** The command that makes a world of two egos or more. */
export const madeBy = () =>
  command(
    `curl -s ${location.origin}/v1/worlds -H "Authorization: Bearer $TOKEN" \\\n  --json '{"benchmark": "fleet", "seed": 0, "record": true}'`,
  );

/** The command with which a worker joins a world as the driver of an ego; two workers of one name would share a place. */
export const joinedBy = (world, ego) =>
  command(`python examples/world_worker.py ${location.origin} $TOKEN ${world.id} ${ego}-driver ${ego} 8.0`);
