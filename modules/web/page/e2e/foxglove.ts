// A run as Foxglove reads it: its own packages open the file, parse each schema, and decode each message in ROS 2 form.
import { deepEqual, equal, ok } from "node:assert/strict";
import { parse } from "@foxglove/rosmsg";
import { MessageReader } from "@foxglove/rosmsg2-serialization";
import { McapIndexedReader } from "@mcap/core";
import { loadDecompressHandlers } from "@mcap/support";
import { scene } from "./support/scene";

/** `sensor_msgs/msg/LaserScan`, as the package gives it. */
interface LaserScan {
  header: { frame_id: string };
  angle_min: number;
  angle_max: number;
  angle_increment: number;
  range_min: number;
  ranges: Float32Array;
  intensities: Float32Array;
}

interface Opened {
  /** Number of messages of each topic in ROS 2 form, and their type. */
  topics: Record<string, { type: string; count: number }>;
  scans: LaserScan[];
}

async function opened(bytes: Buffer): Promise<Opened> {
  const readable = {
    size: async () => BigInt(bytes.length),
    read: async (at: bigint, length: bigint) => new Uint8Array(bytes.subarray(Number(at), Number(at + length))),
  };
  const reader = await McapIndexedReader.Initialize({ readable, decompressHandlers: await loadDecompressHandlers() });
  const readers = new Map<number, { topic: string; type: string; messages: MessageReader }>();
  for (const channel of reader.channelsById.values()) {
    if (channel.messageEncoding !== "cdr") continue;
    const schema = reader.schemasById.get(channel.schemaId);
    ok(schema?.encoding === "ros2msg", channel.topic);
    const messages = new MessageReader(parse(new TextDecoder().decode(schema.data), { ros2: true }));
    readers.set(channel.id, { topic: channel.topic, type: schema.name, messages });
  }
  const found: Opened = { topics: {}, scans: [] };
  for await (const message of reader.readMessages()) {
    const known = readers.get(message.channelId);
    if (!known) continue;
    const value = known.messages.readMessage(message.data);
    (found.topics[known.topic] ??= { type: known.type, count: 0 }).count += 1;
    if (known.topic === "/scan/top") found.scans.push(value as LaserScan);
  }
  return found;
}

scene("a run with a lidar opens in Foxglove's reader, its scans as sensor_msgs/LaserScan", async ({ visit }) => {
  const v = await visit({ as: "operator" });
  await v.go("Logs");
  // A file gets its index when it ends.
  await v.button("Stop recording").click();
  await v.card("Recorder").getByText("not recording", { exact: true }).waitFor();
  const run = await opened((await v.download()).bytes);
  equal(run.topics["/scan/top"]?.type, "sensor_msgs/msg/LaserScan");
  ok(run.scans.length > 1);
  for (const topic of ["/tf", "/scene", "/diagnostics", "/LL_DATA_SCAN", "/LL_DATA_GUARD"]) ok((run.topics[topic]?.count ?? 0) > 0, topic);
  for (const scan of run.scans) {
    equal(scan.header.frame_id, "lidar_top");
    equal(Math.round((scan.angle_max - scan.angle_min) / scan.angle_increment) + 1, scan.ranges.length);
    equal(scan.intensities.length, scan.ranges.length);
  }
  // The hall has walls all around; the first turn begins where the motor was.
  const seen = run.scans.slice(1).map(({ ranges, range_min }) => ranges.filter((range) => range >= range_min && range < 40).length);
  deepEqual(seen.filter((count) => count < 100), [], `${seen}`);
}, [], "conf/courier");
