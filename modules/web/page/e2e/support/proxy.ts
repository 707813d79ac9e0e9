// The network between page and robot, as bad as one wishes: late, stalled, cut.
import { connect, createServer, type Server, type Socket } from "node:net";

export class Proxy {
  /** Each way, ms. */
  delay = 0;
  /** What is sent is not delivered until it is false again; connections stay. */
  stalled = false;
  private closed = false;
  private readonly sockets = new Set<Socket>();

  private constructor(
    private readonly server: Server,
    readonly port: number,
  ) {}

  static open(to: number): Promise<Proxy> {
    return new Promise((take, fail) => {
      const server = createServer({ noDelay: true }, (near) => proxy.join(near, connect({ port: to, host: "127.0.0.1", noDelay: true })));
      let proxy: Proxy;
      server.once("error", fail);
      server.listen(0, "127.0.0.1", () => {
        proxy = new Proxy(server.unref(), (server.address() as { port: number }).port);
        take(proxy);
      });
    });
  }

  /** All connections end, and no new one comes about until `mend`. */
  cut(): void {
    this.closed = true;
    for (const socket of this.sockets) socket.destroy();
  }
  mend(): void {
    this.closed = false;
    this.stalled = false;
    this.delay = 0;
  }
  close(): void {
    this.cut();
    this.server.close();
  }

  private join(near: Socket, far: Socket): void {
    for (const socket of [near, far]) {
      this.sockets.add(socket);
      socket.on("error", () => {});
      socket.on("close", () => {
        this.sockets.delete(socket);
        near.destroy();
        far.destroy();
      });
    }
    if (this.closed) return void near.destroy(), void far.destroy();
    this.pipe(near, far);
    this.pipe(far, near);
  }

  private pipe(from: Socket, to: Socket): void {
    const late: { due: number; bytes: Buffer | null }[] = [];
    let timer: NodeJS.Timeout | null = null;
    const deliver = () => {
      timer = null;
      while (late.length && !this.stalled && (late[0]?.due ?? 0) <= performance.now()) {
        const bytes = late.shift()?.bytes ?? null;
        if (bytes === null) to.end();
        else to.write(bytes);
      }
      if (late.length && !to.destroyed) timer = setTimeout(deliver, this.stalled ? 20 : Math.max(1, (late[0]?.due ?? 0) - performance.now()));
    };
    const take = (bytes: Buffer | null) => {
      late.push({ due: performance.now() + this.delay, bytes });
      if (timer === null) deliver();
    };
    from.on("data", take);
    from.on("end", () => take(null));
  }
}
