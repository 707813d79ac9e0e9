// The service worker: keeps what the page consists of on the device, so that it opens where the robot is not heard yet.
// What changes by itself (/api, /ws, logs) never goes through here.
declare const self: ServiceWorkerGlobalScope;
/** A digest of all the page's files, and their addresses; set by the build. */
declare const VERSION: string;
declare const SHELL: string[];

const KEPT = `page-${VERSION}`;

self.addEventListener("install", (event) => {
  event.waitUntil(caches.open(KEPT).then((cache) => cache.addAll(SHELL.map((path) => new Request(path, { cache: "reload" })))));
});

self.addEventListener("activate", (event) => {
  const old = caches.keys().then((names) => Promise.all(names.filter((name) => name !== KEPT).map((name) => caches.delete(name))));
  event.waitUntil(old.then(() => self.clients.claim()));
});

self.addEventListener("message", (event) => {
  if (event.data === "take over") void self.skipWaiting();
});

self.addEventListener("fetch", (event) => {
  const { request } = event;
  const url = new URL(request.url);
  const path = url.pathname;
  if (request.method !== "GET" || url.origin !== self.location.origin || !SHELL.includes(path)) return;
  event.respondWith(caches.open(KEPT).then(async (cache) => (await cache.match(path)) ?? fetch(request)));
});

export {};
